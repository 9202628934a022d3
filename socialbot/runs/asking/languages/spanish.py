"""Spanish questions and answers."""

import re

from socialbot.runs.asking.languages.language import Language, Voices, word_set

SPANISH = Language(
    "es",
    {
        "why": (
            "por que,por que razon,por cual motivo,razon,motivo,a que se debe,como es que,explica,para que,"
            "que te hizo,que te llevo,como decidiste,como sabias,como supiste,en que te basaste,en base a que,"
            "que te hizo pensar,con que motivo,debido a que"
        ),
        "what": "que,que cosa,algo,describe,cual,como reaccionaste",
        "who": "quien,quienes,a quien,a quienes,que personas,que persona,que visitantes,que robot,que agente,de quien",
        "when": "cuando,a que hora,en que momento,desde cuando",
        "how_often": "cuantas veces,con que frecuencia,cada cuanto",
        "how_many": "cuantas,cuantos,cuanta,numero de",
        "unanswerable": (
            "como se llama,como se llamaba,como te llamas,que edad,que color,como,cuanto,a quien pertenece,"
            "pertenece,de quien es"
        ),
        "not": "no,nunca,jamas,ningun,ninguna,tampoco,sin,olvidaste",
        "see": (
            "ves,viste,ver,visto,veias,miras,notas,notaste,delante de ti,visible,observas,observaste,camara,ve,vio,"
            "vieron,visteis,veia,veian,ven,veis"
        ),
        "do": (
            "haces,hiciste,hacer,hecho,hacias,haras,hace,ocupado,haciendo,reaccionaste,hizo,hicieron,hicisteis,"
            "hacian,haciais,hacen,haceis,hacia"
        ),
        "happen": "pasa,paso,pasado,ocurre,ocurrio,sucedio",
        "next": "despues,luego,siguiente,proximo,proxima,a continuacion",
        "plan": (
            "por hacer,algo que hacer,planeas,planeabas,piensas,pensabas,quieres,querias,ibas a,vas a,"
            "intencion,objetivo,plan,meta,pretendes,"
            "haras,vais a,va a,van a,pensais,piensa,quereis,quiere,planeais,planea,piensan,quieren"
        ),
        "outcome": (
            "fin,termino,terminado,terminada,exito,logrado,logro,resultado,acabo,acabado,salio bien,fue bien,ido bien"
        ),
        "fail": "problema,problemas,fallo,fallar,fallado,fallaste,error,salio mal,fue mal,ido mal,dificultad,"
        "accidente,incidente,averia",
        "say": (
            "dices,dijiste,decir,dicho,hablaste,frase,palabras,dijo,dijeron,dijisteis,dice,dicen,decia,decias,hablo,"
            "hablaron,hablado,hablabas,contestaste,contesto,respondiste,respondio,contaste,conto,contado,preguntaste,"
            "pregunto,preguntado,pediste,pidio,pedido,mencionaste,explicaste,explico,dije,pregunte,"
            "hable,respondi,conteste,pedi"
        ),
        "hear": "oiste,oyes,oido,oias,oir,escuchaste,escuchado,escuchas",
        "replies": "respondi,respondio,respondiste,respondido,conteste,contesto,contestaste,contestado",
        "asks": "pediste,pidio,pedido,pedir,preguntaste,pregunto,preguntado,preguntar",
        "here": (
            "aqui,aca,ahi,vino,vinieron,estuvo,estuvieron,llego,visito,presente,alli,vine,quedo,quedaron,fue,marcho,"
            "salio,permanecio,vinimos,quede,llegue,llegaron,salieron,marcharon,estuve,estuvimos,llegado,venido,"
            "quedado"
        ),
        "people": "gente,persona,personas,visitante,visitantes,hombre,mujer,alguien,invitado,humano,nino",
        "group": "pareja",
        "nobody": "nadie,vacio,vacia",
        "me": "me,mi,yo,nos,nosotros,conmigo",
        "you": "tu,te,ti,usted,robot,vosotros",
        "them": "lo,la,le,los,les,ella,el,ellos",
        "past": (
            "vino,vinieron,llego,has,he,ha,han,fue,era,estaba,estaban,estuvo,hiciste,viste,dijiste,habia,ya,antes,"
            "hizo,hicieron,hacia,hacias,"
            "hasta ahora"
        ),
        "future": "vas a,haras,proximo,siguiente,despues,va a,vais a,van a,hareis,haran,hara",
        "present": "estas,es,son,puedes,ahora,actualmente,ves,haces,esta",
        "ago": "hace",
        "first": "primero,primera,primer,al principio",
        "last": "ultimo,ultima",
        "ordinals": "segundo,tercero,cuarto,quinto,sexto,septimo,octavo,noveno,decimo",
        "time": "vez,veces",
        "seconds": "s,seg,segundo,segundos",
        "minutes": "min,minuto,minutos",
        "at": "a,en,despues de,tras,sobre",
        "end": "al final,al terminar,hacia el final,cerca del final,finalmente,por fin",
        "overall": "en total,hasta ahora",
        "talk": "hablar,hablaste,hablado",
        "silent": "callado,silencioso,mudo,silencio,callaste,abstuviste",
        "request": "puedes,podrias,puede usted,por favor",
        "start": "al principio,al comienzo,al inicio",
        "recently": "ahora mismo,hace un momento,recien,ahora",
        "how_long": (
            "cuanto tiempo,durante cuanto tiempo,cuantos segundos,cuantos minutos,desde cuando,hace cuanto,"
            "cuanto tardaste,cuanto tardo"
        ),
        "where": "donde,adonde,a donde,en que lugar,de donde",
        "how_far": "a que distancia,que distancia,que tan lejos,que tan cerca,como de lejos",
        "auxiliary": "has,ha,han,habias,estas,esta,estaba,fue,hubo",
        "all": "todos,todas,todo el mundo,cada",
        "shortest": "menos tiempo,mas corta",
        "longest": "mas tiempo",
        "but": "pero,y,mientras que",
        "rather": "en vez de,en lugar de,y no,pero no",
        "event after": (
            "despues de que,despues de,tras,en cuanto,una vez que,tan pronto como,mas tarde que,despues del,luego de"
        ),
        "event before": "antes de que,antes de,hasta que,y luego,y despues,antes del",
        "follows": "siguio a,siguio al,sigue a,vino despues de,vino despues del,vino tras",
        "precedes": "precedio a,precedio al,vino antes de,vino antes del",
        "event when": "cuando,mientras,al momento en que",
        "comes": "llego,llegaron,vino,vinieron,entro,entraron,aparecio,llegar",
        "leaves": "fue,fueron,marcho,marcharon,salio,salieron,desaparecio,irse,ido",
        "waits": "esperaste,esperar,tardaste",
        "matrix": (
            "saber,sabes,sabe,decir,decirme,dime,digas,diga,recuerdas,recordar,acuerdas,pregunto,preguntar,gustaria,"
            "quisiera,quiero,quieres,interesa,entiendo,entender,seguro,idea,explicar,explicarme,puedes,podrias,puede,"
            "podria,curiosidad,amable,encantaria,verdad,cierto,contar,contarme"
        ),
        "or": "o,u",
        "which": "cual,cuales",
        "why not": "por que no",
        "complement": "si,verdad que,cierto que,seguro que",
        "times": (
            "una vez,dos veces,tres veces,varias veces,muchas veces,otra vez,de nuevo,nuevamente,una sola vez,"
            "mas de una vez,cada vez,siempre,repetidamente"
        ),
        "others": (
            "alguien mas,nadie mas,otra,otro,otros,otras,aparte de,ademas de,excepto,salvo,menos a,solo,solamente,"
            "unicamente,la mayoria"
        ),
        "hypothetical": "y si,que pasaria,que habria,que habrias,habrias,que harias,hubiera",
        "qualified": (
            "porque,juntos,juntas,al mismo tiempo,a la vez,antes que,mas tarde,en vez de,en lugar de,"
            "demasiado,a tiempo,casi,apenas,enseguida,por error,a una mujer,a un hombre,a un nino,mujeres,"
            "hombres,ninos,en espanol,en ingles"
        ),
        "filler": (
            "disculpa,disculpe,perdon,perdona,perdone,a proposito de,acerca de,respecto a,recibio,obtuvo,momento,eh,"
            "pues,hoy,bueno,este,oiga,por favor,hola,oye,dime,puedes decirme,"
            "podrias decirme,sabes,quiero saber,el,la,los,las,un,una,unos,de,del,a,al,y,en,con,lo,le,se,es,que,para,"
            "su,tu,esto,eso,segundo,mi,ese,si,veces,vez,en total,o,cosa,cosas,realmente,simplemente,juntos,"
            "necesitaba,fue,ultimo que,entretanto,lugar,equipo,robots,sus,tus,mis,nuestro,"
            "nuestra,nuestros,nuestras,en medio de tu trabajo,en medio del trabajo,en mitad del trabajo,"
            "durante el trabajo"
        ),
        "left out": (
            "olvidaste,nada,manos vacias,excluido,excluida,olvidado,olvidada,ignorado,ignorada,desatendido,desatendida"
        ),
        "between": "entre",
        "called": "llamado,llamada,de nombre,que se llama,que se llamaba",
        "step": "paso,pasos",
        "replan": (
            "nuevo plan,plan nuevo,otro plan,replanificar,replanificaste,replanificado,plan distinto,"
            "plan diferente,cambiaste de plan,cambiar de plan,cambiado de plan,cambiaste tu plan,"
            "cambiaste el plan,segundo plan"
        ),
        "to": "a,al,hacia,en,hasta",
        "being": "es,era,son,eran,fue,fueron,ha sido,hay,habia,hubo,estaba",
        "at place": "en,dentro,sobre,encima,bajo,debajo,detras,delante,junto,entre,cerca,adentro",
        "from": "de,del,desde,dejaste,dejo,abandonaste",
        "article": "el,la,los,las,un,una",
    },
    {
        "because": " porque",
        "decimal": ",",
        "and": "y",
        "at": "a los {at} s",
        "within": "de {at} a {until} s {clause}",
        "ago": "hace {ago} segundos",
        "just_now": "hace un momento",
        "then": "{when} {clause}",
        "person": "la persona {id}",
        "somebody": "alguien",
        "anybody": "nadie",
        "yes": "Sí",
        "no": "No",
        "unknown": "No lo sé",
        "unclear": "No estoy seguro de entender la pregunta",
        "able": (
            "Puedo decir por qué hice o no hice algo, qué vi, dije, hice y pensaba hacer, y quién estuvo aquí y cuándo"
        ),
        "not_recorded": "el registro no lo dice",
        "belief": "yo creía {what}",
        "no_belief": "yo no creía {what}",
        "saw_none": "no veía a nadie",
        "saw_one": "veía a {people}",
        "away": "{person} a {distance} m",
        "side": "{person} {side} de la imagen",
        "sides": "a la izquierda|en el centro|a la derecha",
        "nobody_came": "no hubo nadie aquí",
        "here": "{person} estuvo aquí de {at} a {until} s",
        "here_you": "estuviste aquí de {at} a {until} s",
        "counted": "{count} personas estuvieron aquí",
        "counted_one": "una persona estuvo aquí",
        "times": "{count} veces",
        "people": "{count} personas",
        "people_one": "una persona",
        "times_one": "una vez",
        "said": "dije «{what}»",
        "heard": "{person} dijo «{what}»",
        "heard_you": "dijiste «{what}»",
        "failed": "fallé en {what}{why}",
        "ended": "el plan para {what} terminó: {outcome}{why}",
        "nothing_failed": "nada falló",
        "took": "eso duró {value} s",
        "said_nothing": "no dije nada",
        "not_named": "el registro no menciona «{word}»",
        "said_no_words": "no dije «{what}»",
        "nothing_next": "no tenía ninguna intención",
        "next_was": "lo siguiente fue {when}: {clause}",
        "last_was": "lo último fue {when}: {clause}",
        "nothing_done": "no hacía nada",
        "wanted": "yo quería {what}",
        "assumes": "Te tomo por la persona {id}.",
        "examples": "¿Qué ves? | ¿Qué hiciste a los {at} segundos? | ¿Quién estuvo aquí? | ¿Qué harás después?",
    },
    Voices(
        you=word_set("tu usted"),
        to_you=word_set("te ti"),
        passive=word_set("fue fuiste fueron sido siendo"),
        by=word_set("por"),
        receive=word_set("recibio recibiste recibido obtuvo obtuviste"),
        source=word_set("de"),
        third=word_set("ha han habia habian"),
        participle=re.compile(".*d[oa]s?"),
        second=re.compile(".*(s|ste)"),
        first=word_set("he hemos dije di pregunte pedi conteste respondi hable salude agradeci"),
    ),
    letters="¿¡ñáíóú",
)
